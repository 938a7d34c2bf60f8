"""HTTP served to others: listening sockets, protected addresses, limits of connections and requests."""
