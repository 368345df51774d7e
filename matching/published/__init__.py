"""Published matchers, rebuilt: the GATv2-Sinkhorn network with its training, and iS-Graphs' search.

"Learning-Based Hierarchical Scene Graph Matching for Robot Localization Leveraging Prior Maps" (Ndulue,
Millan-Romera, et al.); where the paper is silent, the authors' public code. `combinatorial` names the search's.
"""
