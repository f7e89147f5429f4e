"""Start the payload estimator alone, for a real arm that publishes joint_states and strain."""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

# What the node hears, under the arm's own names.
TOPICS = {
    'joint_states': ('joint_states', "the arm's topic of joint states"),
    'strain': ('strain', "the arm's topic of strain"),
    'command': ('command', "the topic of your controller's commands"),
}
ARGUMENTS = {
    'robot': ('reference', "the arm's own robot file"),
    'namespace': ('', 'namespace of node and topics'),
    'params_file': ('', 'ROS parameter file; what it says goes before robot'),
    'use_sim_time': ('false', 'whether the node takes the time from /clock, as for a bag'),
    'record': ('false', 'whether a bag of every topic is recorded'),
    **TOPICS,
}


def nodes(context: LaunchContext) -> list[Node]:
    """Return the estimator with what the arguments say."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    common: dict[str, Any] = {'robot': given['robot'],
                              'use_sim_time': given['use_sim_time'].lower() == 'true'}
    files = [given['params_file']] if given['params_file'] else []
    return [Node(package='flex_payload', executable='payload_estimator', output='screen',
                 namespace=given['namespace'], parameters=[common, *files],
                 remappings=[(name, given[name]) for name in TOPICS])]


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, start the node, and record where asked."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, (default, text) in ARGUMENTS.items()),
        OpaqueFunction(function=nodes),
        ExecuteProcess(cmd=['ros2', 'bag', 'record', '-a'], output='screen',
                       condition=IfCondition(LaunchConfiguration('record')))])
