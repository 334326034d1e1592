"""Whole-body control: from a plan and the state to joint torques, one QP a tick."""
