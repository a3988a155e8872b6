"""What a results folder says of all its devices together: the population, its members, their effects."""
