# Each target does its own set-up: it says what it installs, and why.
RECORDING ?=

.PHONY: help demo test bench

help:
	@echo 'make demo   grow a meadow from a shipped recording: in a window, else in picture files (demo-out/)'
	@echo '            RECORDING=path plays another recording'
	@echo 'make test   every check and every test'
	@echo 'make bench  times of the stages beside OpenCV, and the memory of a long replay'

demo:
	@.ci/demo $(RECORDING)

test:
	@.ci/test

bench:
	@.ci/bench
