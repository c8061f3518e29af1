"""Tables of pictures and of what is known of each, as people write them: CSV or Parquet, to presses in mm and N."""
