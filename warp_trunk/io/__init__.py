"""Files opened, read and written so that a damaged one does no harm. May import `geometry`, `engine` and below."""
