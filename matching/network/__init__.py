"""The graph network that proposes matches, in PyTorch, and its input features."""
