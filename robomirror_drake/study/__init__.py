"""Studies: methods of adaptation side by side, on the same commands in the same physics."""
