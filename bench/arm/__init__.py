"""Targets, paths and independent solvers that `python -m bench.arm_ik` judges ArmIK by."""
