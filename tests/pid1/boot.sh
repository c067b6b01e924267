#!/bin/sh
# Starts systemd as process 1 of namespaces of its own, with the units of $1/units and nothing else: boot.sh FOLDER.
# Needs root. What it mounts is seen by nobody else and gone with it; so is its control group.
# In FOLDER: units/ (the units), bin/ (programs), etc/ (what is to be /etc/sward).
set -eu
folder=$1
case ${2:-outside} in
outside)
  exec unshare --mount "$0" "$folder" mounted
  ;;
mounted)
  mount --make-rprivate /
  mkdir -p "$folder/cgroup"
  mount -t cgroup2 cgroup2 "$folder/cgroup"
  cgroup=$folder/cgroup/sward-pid1-$$
  mkdir "$cgroup"
  trap 'find "$cgroup" -depth -type d -exec rmdir {} +' EXIT
  (
    # This subshell, and so what becomes of it.
    sh -c "echo \$PPID" >"$cgroup/cgroup.procs"
    exec unshare --pid --fork --uts --ipc --net --cgroup --mount --mount-proc --kill-child "$0" "$folder" inside
  ) || true
  ;;
inside)
  umount -R /sys/fs/cgroup 2>/dev/null || true
  mount -t cgroup2 cgroup2 /sys/fs/cgroup
  for file in passwd group; do
    cp "/etc/$file" "$folder/$file"
  done
  id=4711
  for user in sward sward-render; do
    grep -q "^$user:" "$folder/group" || echo "$user:x:$id:" >>"$folder/group"
    grep -q "^$user:" "$folder/passwd" || echo "$user:x:$id:$id::/:/usr/sbin/nologin" >>"$folder/passwd"
    id=$((id + 1))
  done
  # As sysusers.d says: the meadow may connect to the station.
  grep -q '^sward:.*sward-render' "$folder/group" || sed -i 's/^sward:[^:]*:[^:]*:.*[^:]$/&,/; s/^sward:.*/&sward-render/' "$folder/group"
  for file in passwd group; do
    mount --bind "$folder/$file" "/etc/$file"
  done
  mount -t tmpfs -o mode=755 tmpfs /run
  mkdir -p /run/sward-test /run/systemd/system
  cp -r "$folder/bin" "$folder/etc" /run/sward-test
  # The machine's own units are none of this one's.
  mount -t tmpfs -o mode=755 tmpfs /usr/lib/systemd/system
  [ -d /lib/systemd/system ]
  mount -t tmpfs -o mode=755 tmpfs /etc/systemd/system
  mount -t tmpfs -o mode=755 tmpfs /var/lib
  mount -t tmpfs -o mode=755 tmpfs /var/cache
  cp "$folder"/units/* /etc/systemd/system
  : >"$folder/console"
  mount --bind "$folder/console" /dev/console
  exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin container=sward \
    /lib/systemd/systemd --system --unit=sward-test.target --log-target=console --log-level=info --show-status=0
  ;;
esac
