"""Every action that the library knows executed, to see what the robot can do."""
