"""Pages that show what happened, and the drawings in them."""
