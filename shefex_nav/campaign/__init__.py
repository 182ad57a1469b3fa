"""Campaigns: many runs of one scenario with dispersions, and what they say."""
