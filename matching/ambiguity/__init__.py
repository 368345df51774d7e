"""Before any robot drives: symmetries of a plan, its defects, and how many rooms must be seen to localise in it."""
