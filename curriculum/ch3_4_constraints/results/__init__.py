"""What a run leaves: the table, the files and the recording, in one palette."""
