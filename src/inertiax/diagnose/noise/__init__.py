"""The noise of the rows: state-space form, restricted maximum likelihood, what channels and units share."""
