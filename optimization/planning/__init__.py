"""From a kinematic reference to a plan that the dynamics allow."""
