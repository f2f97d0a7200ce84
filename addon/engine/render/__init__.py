"""Final renders with Relume as render engine."""
