"""Ablation of the SLAM system: variants with parts of it left out."""
