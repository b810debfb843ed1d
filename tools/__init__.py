"""Programs for developers who change or release the server; run from the checkout, not installed."""
