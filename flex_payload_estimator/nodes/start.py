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
    NODES = {'payload_estimator': payload_estimator, 'lqg_controller': lqg_controller}
    asked = sys.argv[1] if len(sys.argv) > 1 else 'none'
    if asked not in NODES:
        sys.stderr.write(f'error: NODE: expected {" or ".join(NODES)}, got {asked}\n')
        sys.exit(2)
    del sys.argv[1]
    NODES[asked]()
