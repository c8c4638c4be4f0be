"""Evaluation of trained policies: runs, results, robustness, policy selection, studies."""
