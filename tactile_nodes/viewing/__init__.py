"""What somebody who watches the sensor knows, in a terminal or in a browser: plain objects that are fed by hand."""
