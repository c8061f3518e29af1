"""Tables of images with their measurements, written by users as CSV or Parquet, converted to presses in mm and N."""
