"""Commands that train, tune and publish."""
