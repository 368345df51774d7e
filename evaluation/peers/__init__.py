"""Published systems by others, each with its best settings for indoors."""
