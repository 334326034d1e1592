"""Speed and quality of the stages, beside their peers."""
