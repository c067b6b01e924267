# Each target does its own set-up: it says what it installs, and why.
RECORDING ?=
SECONDS ?= 60
START ?= 0
ONLY ?=
PUBLISHES ?= 100000
KILLS ?= 1000
FAULTS_S ?= 3600

.PHONY: help demo test bench figures soak fuzz vm-test recordings goldens pictures

help:
	@echo 'make demo   grow a meadow from a shipped recording: in a window, else in picture files (demo-out/)'
	@echo '            RECORDING=path plays another recording'
	@echo 'make test   every check and every test'
	@echo 'make fuzz   recordings, configurations, previews and depth that nobody would make, SECONDS=60 of each kind;'
	@echo '            START=case goes on behind the cases that were run before'
	@echo 'make vm-test   cameras that the kernel reads: in a small emulated machine, also part of make test'
	@echo 'make recordings   the shipped recordings anew, with their truth and checksums'
	@echo 'make pictures   the pictures of renderer/docs anew (minutes)'
	@echo 'make goldens   the pictures that the tests of the renderer expect, anew; look at them before they are kept'
	@echo 'make bench  times of the stages beside OpenCV, and the memory of a long replay'
	@echo 'make figures   latency from frame to picture, publishing, processor time and start, as a table (6 min);'
	@echo '            ONLY="latency publish cpu start" measures some of it'
	@echo 'make soak   what takes long in place of seconds: PUBLISHES=100000 in flat memory, KILLS=1000 of the daemon,'
	@echo '            a tenth of them while it records, and FAULTS_S=3600 seconds of faults of its sensor'

demo:
	@.ci/demo $(RECORDING)

test:
	@.ci/test

fuzz:
	@.ci/fuzz $(SECONDS) $(START)

vm-test:
	@.ci/vm

bench:
	@.ci/bench

figures:
	@.ci/figures $(ONLY)

soak:
	@.ci/soak $(PUBLISHES) $(KILLS) $(FAULTS_S)

pictures:
	@.ci/pictures

goldens:
	@.ci/goldens

recordings:
	@.ci/recordings
