"""What a language model is offered over the Model Context Protocol (``mcserver mcp``, extra ``mcp``)."""
