"""A run in the browser, live or finished."""
