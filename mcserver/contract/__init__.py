"""The wire as data: what `clients/contract` holds, made from the messages of the server."""
