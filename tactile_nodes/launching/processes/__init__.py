"""The processes of a launch: started, watched, heard, ended."""
