"""The evaluations whose results are kept, one file each."""
