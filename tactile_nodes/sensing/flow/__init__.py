"""How far the picture's content moved beside the rest image."""
