"""From a data set of executions to trained performance predictors, and how good they are."""
