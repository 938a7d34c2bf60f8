"""``mcserver view``: the machine in three dimensions in a browser. Scene computing apart from drawing."""
