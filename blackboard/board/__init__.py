"""The board of a sub-team: reports in, consensuses out."""
