"""The ablation of the SLAM system."""
