"""Reading of a scene as final renders see it."""
