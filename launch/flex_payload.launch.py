"""Start the arm, the payload estimator and the controller."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    'robot': ('reference', 'built-in robot or robot file, for all three nodes'),
    'payload': ('0.1', 'payload of the simulated arm, kg'),
    'mode': ('lockstep', 'lockstep or realtime'),
}


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the three nodes."""
    robot = {'robot': LaunchConfiguration('robot')}
    plant = {
        'payload': ParameterValue(LaunchConfiguration('payload'), value_type=float),
        'mode': LaunchConfiguration('mode'),
    }
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, (default, text) in ARGUMENTS.items()),
        Node(package='flex_payload', executable='plant_sim', parameters=[robot, plant]),
        Node(package='flex_payload', executable='payload_estimator', parameters=[robot]),
        Node(package='flex_payload', executable='lqg_controller', parameters=[robot]),
    ])
