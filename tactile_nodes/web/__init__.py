"""The live view in a browser: its content, the server, and the page itself."""
