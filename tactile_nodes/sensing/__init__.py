"""Numbers from numbers: image to displacement, displacement to features, features to force."""
