"""Programs for those who change or release the server; run from the checkout, not installed."""
