# Stands in for the package of these messages.
