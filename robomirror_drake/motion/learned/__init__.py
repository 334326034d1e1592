"""The learned generator: text to motion by latent diffusion, trained on HumanML3D's layout.

Nothing here is imported before it is asked for: torch takes seconds to load.
"""
