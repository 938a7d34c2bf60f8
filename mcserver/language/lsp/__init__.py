"""The language server: what editors ask about a program (``mcserver lsp``, extra ``lsp``)."""
