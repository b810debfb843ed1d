"""Bad and extreme inputs as data: the requests and their expected answers."""
