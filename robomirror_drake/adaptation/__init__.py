"""What the robot makes of a command: candidates ranked, chosen or changed, also on the way."""
