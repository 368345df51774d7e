"""Published methods and tables, reproduced and compared with ours."""
