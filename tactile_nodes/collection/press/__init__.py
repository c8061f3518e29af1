"""One press: procedures, and what they measure."""
