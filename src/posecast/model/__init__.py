"""Backbones, heads, the forecaster, its rollout, and baselines without a network."""
