"""Bad and extreme inputs as data: what is sent, what has to be answered."""
