"""The site of pages: the repository's Markdown with a search, beside references made from the source."""
