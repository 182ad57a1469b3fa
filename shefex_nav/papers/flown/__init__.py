"""The papers' systems in flight, from their scenarios, beside the default chain.

flights      the scenarios, the chains, and what a flight says of each
experiments  what `reproduce as-flown` shows of them
"""
