"""The published GATv2-Sinkhorn matcher, rebuilt from its paper, with its training.

"Learning-Based Hierarchical Scene Graph Matching for Robot Localization Leveraging Prior Maps" (Ndulue,
Millan-Romera, et al.); where the paper is silent, the authors' public code.
"""
