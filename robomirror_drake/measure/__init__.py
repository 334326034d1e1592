"""Text to motion measured: understood, human, diverse, quick."""
