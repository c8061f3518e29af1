"""The state behind the views in a terminal and in a browser: plain objects that are fed with messages."""
