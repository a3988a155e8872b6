"""Recordings to what estimators use: rests, segments, dwell means with covariances, rotations between rests."""
