"""From a human motion to the robot's kinematic reference."""
