"""Entry points of the nodes; `python -m flex_payload_estimator.nodes.start NODE` runs one."""

import sys

from msg_config.node_start import run_node


def payload_estimator() -> None:
    """Run payload_estimator until Ctrl-C."""
    run_node('flex_payload_estimator.nodes.payload_estimator_node', 'PayloadEstimatorNode')


def lqg_controller() -> None:
    """Run lqg_controller until Ctrl-C."""
    run_node('flex_payload_estimator.nodes.lqg_controller_node', 'LQGControllerNode')


if __name__ == '__main__':
    {'payload_estimator': payload_estimator, 'lqg_controller': lqg_controller}[sys.argv.pop(1)]()
