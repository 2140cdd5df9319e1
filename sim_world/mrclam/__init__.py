"""A recorded real team in the MRCLAM format: its files, and their replay."""
