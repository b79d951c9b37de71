"""The documentation: Markdown pages, and in `docs.site` what makes the others of the site."""
