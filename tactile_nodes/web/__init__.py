"""The live view in a browser: what the page shows, the server that brings it there, and the page itself."""
