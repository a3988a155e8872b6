"""How large, where, and how well it predicts data left out."""
