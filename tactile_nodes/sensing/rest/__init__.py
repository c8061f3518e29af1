"""The rest image: captured, prepared, and taken anew."""
