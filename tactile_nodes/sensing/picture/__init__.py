"""What is wrong with a picture, and whether its camera or anything on the gel moved."""
