"""Runs of a fleet: closed and open loops, estimated poses, recording and replays of logs."""
