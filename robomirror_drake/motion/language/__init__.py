"""What a sentence in English asks for: words, quantities, likeness of meaning."""
