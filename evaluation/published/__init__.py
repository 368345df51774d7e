"""Published methods and tables, reproduced beside ours."""
