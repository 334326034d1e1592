"""Text to human motion: file formats, library, actions, composer, generator."""
