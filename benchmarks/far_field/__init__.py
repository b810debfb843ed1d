"""What sums over far boundary nodes cost, taken together within a tolerance, beside the direct ones."""
