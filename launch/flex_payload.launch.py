"""Start the arm, the payload estimator and the controller: the whole loop in simulation."""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    'robot': ('reference', 'built-in robot or robot file, for all three nodes'),
    'payload': ('-1', "payload of the simulated arm, kg; -1 takes the robot file's"),
    'mode': ('lockstep', 'lockstep or realtime'),
    'namespace': ('', 'namespace of nodes and topics'),
    'params_file': ('', 'ROS parameter file; what it says goes before robot, payload and mode'),
    'use_sim_time': ('false', 'whether the nodes take the time from /clock'),
    'record': ('false', 'whether a bag of every topic is recorded'),
}


def nodes(context: LaunchContext) -> list[Node]:
    """Return the three nodes with what the arguments say."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    common: dict[str, Any] = {'robot': given['robot'],
                              'use_sim_time': given['use_sim_time'].lower() == 'true'}
    plant = {**common, 'payload': float(given['payload']), 'mode': given['mode']}
    files = [given['params_file']] if given['params_file'] else []
    options: dict[str, Any] = {
        'package': 'flex_payload', 'namespace': given['namespace'], 'output': 'screen'}
    return [
        Node(executable='plant_sim', parameters=[plant, *files], **options),
        Node(executable='payload_estimator', parameters=[common, *files], **options),
        Node(executable='lqg_controller', parameters=[common, *files], **options)]


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, start the nodes, and record where asked."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, (default, text) in ARGUMENTS.items()),
        OpaqueFunction(function=nodes),
        ExecuteProcess(cmd=['ros2', 'bag', 'record', '-a'], output='screen',
                       condition=IfCondition(LaunchConfiguration('record')))])
