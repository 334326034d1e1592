"""Human motion composed of written actions: scores, gaits, keyed gestures, balance."""
