"""References changed as little as it takes to be judged safe, and ways to go on while one runs."""
