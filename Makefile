# Each target does its own set-up: it says what it installs, and why.
RECORDING ?=
SECONDS ?= 60
START ?= 0

.PHONY: help demo test bench fuzz recordings

help:
	@echo 'make demo   grow a meadow from a shipped recording: in a window, else in picture files (demo-out/)'
	@echo '            RECORDING=path plays another recording'
	@echo 'make test   every check and every test'
	@echo 'make fuzz   recordings, configurations and depth that nobody would make, SECONDS=60 of each kind;'
	@echo '            START=case goes on behind the cases that were run before'
	@echo 'make recordings   the shipped recordings anew, with their truth and checksums'
	@echo 'make bench  times of the stages beside OpenCV, and the memory of a long replay'

demo:
	@.ci/demo $(RECORDING)

test:
	@.ci/test

fuzz:
	@.ci/fuzz $(SECONDS) $(START)

bench:
	@.ci/bench

recordings:
	@.ci/recordings
