"""Other libraries on the same task: `python -m bench.peers.pose_tracking` (extra `peers`)."""
