"""
The contract between the nodes: topics, parameters, messages, and the common part of all nodes.

Nothing is imported here, so that `quiet_start` can be imported first.
"""
