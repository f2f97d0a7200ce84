"""The panel of shots: the list, baking several, and their contact sheet."""
