"""What trained policies achieve: runs, results, robustness, policy selection, studies."""
