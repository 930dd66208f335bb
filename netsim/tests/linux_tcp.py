"""What Linux's TCP does when certain packets are lost: the real kernel in two network namespaces, joined by two TUN devices and
this relay. Prints, for each case, when the last byte of a burst was read, counted from when it was written. Needs root."""
import fcntl, heapq, os, select, statistics, struct, subprocess, sys, time

ONE_WAY = 0.025
MSS = 1448
# name: (bytes of the burst, packets of it that are lost the first time, all lost until so many seconds after the first)
CASES = {
    "a lone packet": (100, {0}, 0),
    "the fourth of ten": (10 * MSS, {3}, 0),
    "the last two of ten": (10 * MSS, {8, 9}, 0),
    "the last of ten": (10 * MSS, {9}, 0),
    "all of ten": (10 * MSS, set(range(10)), 0),
    "nothing": (10 * MSS, set(), 0),
    "a way dead for 3 s": (100, set(), 3.0),
}
SERVER = """
import socket, sys, time
s = socket.socket(); s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
s.bind(("10.9.0.2", 7000)); s.listen(); print("up", flush=True)
c, _ = s.accept()
n = 0; want = int(sys.argv[1]); warm = int(sys.argv[2])
while n < warm + want:
    n += len(c.recv(1 << 20))
    if n == warm: print("warm", flush=True)
print(time.monotonic(), flush=True)
time.sleep(0.2)
"""
CLIENT = """
import socket, sys, time
c = socket.socket(); c.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
c.setsockopt(socket.IPPROTO_TCP, 13, b"cubic")
c.connect(("10.9.0.2", 7000))
want = int(sys.argv[1]); warm = int(sys.argv[2])
for _ in range(4):
    c.sendall(bytes(warm // 4)); time.sleep(0.3)
print("ready", flush=True); sys.stdin.readline()
import struct
info = c.getsockopt(socket.IPPROTO_TCP, 11, 104)
rto, = struct.unpack_from("I", info, 8); rtt, var = struct.unpack_from("II", info, 68); cwnd, = struct.unpack_from("I", info, 80)
print("info", rto, rtt, var, cwnd, flush=True)
print(time.monotonic(), flush=True); c.sendall(bytes(want))
time.sleep(8)
"""
WARM = 4 * 4 * MSS

def sh(text): subprocess.run(text, shell=True, check=True)

def tun(name):
    fd = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(fd, 0x400454CA, struct.pack("16sH", name.encode(), 0x0001 | 0x1000))
    return fd

def run(burst, lost, dead):
    for ns, dev, ip in (("tri-a", "tria", "10.9.0.1"), ("tri-b", "trib", "10.9.0.2")):
        sh(f"ip netns add {ns}")
    fds = tun("tria"), tun("trib")
    try:
        for ns, dev, ip in (("tri-a", "tria", "10.9.0.1"), ("tri-b", "trib", "10.9.0.2")):
            sh(f"ip link set {dev} netns {ns} && ip netns exec {ns} sh -c 'ip addr add {ip}/24 dev {dev}; ip link set {dev} up; "
               f"sysctl -qw net.ipv4.tcp_no_metrics_save=1 || true'")
        args = [str(burst), str(WARM)]
        server = subprocess.Popen(["ip", "netns", "exec", "tri-b", sys.executable, "-c", SERVER] + args, stdout=subprocess.PIPE, text=True)
        server.stdout.readline()
        client = subprocess.Popen(["ip", "netns", "exec", "tri-a", sys.executable, "-c", CLIENT] + args, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        os.set_blocking(client.stdout.fileno(), False); os.set_blocking(server.stdout.fileno(), False)
        waiting, order, first, seen, started, began, ended, again = [], 0, None, set(), False, None, None, 0
        first_at = None
        give_up = time.monotonic() + 20
        while ended is None and time.monotonic() < give_up:
            now = time.monotonic()
            wait = max(0, waiting[0][0] - now) if waiting else 0.01
            ready, _, _ = select.select(fds, [], [], min(wait, 0.01))
            for fd in ready:
                try: packet = os.read(fd, 65536)
                except BlockingIOError: continue
                if packet[0] >> 4 != 4 or packet[9] != 6: continue
                drop = False
                if fd == fds[0]:
                    ihl = (packet[0] & 15) * 4
                    seq, = struct.unpack_from("!I", packet, ihl + 4)
                    if packet[ihl + 13] & 2: first = seq + 1
                    size = len(packet) - ihl - (packet[ihl + 12] >> 4) * 4
                    offset = (seq - first) % (1 << 32) - WARM
                    if size > 0 and 0 <= offset < burst:
                        if first_at is None: first_at = time.monotonic()
                        index = offset // MSS
                        if index in seen: again += 1
                        drop = (index in lost and index not in seen) or time.monotonic() < first_at + dead
                        seen.add(index)
                if not drop:
                    order += 1
                    heapq.heappush(waiting, (time.monotonic() + ONE_WAY, order, fds[1] if fd == fds[0] else fds[0], packet))
            while waiting and waiting[0][0] <= time.monotonic():
                _, _, to, packet = heapq.heappop(waiting)
                os.write(to, packet)
            line = client.stdout.readline()
            if line == "ready\n": client.stdin.write("go\n"); client.stdin.flush()
            elif line.startswith("info"): info = [int(x) for x in line.split()[1:]]
            elif line: began = float(line)
            line = server.stdout.readline()
            if line and line[0].isdigit(): ended = float(line)
        client.kill(); server.kill(); client.wait(); server.wait()
        print(f"    timeout {info[0]} us, round trip {info[1]} us: {(ended - began) * 1e3:.1f} ms" if ended else "    timed out", flush=True)
        return (ended - began) * 1e3 if ended and began else float("nan"), again
    finally:
        for fd in fds: os.close(fd)
        for ns in ("tri-a", "tri-b"): subprocess.run(["ip", "netns", "del", ns])

repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 3
for name, case in CASES.items():
    got = [run(*case) for _ in range(repeats)]
    print(f"{name:24} {statistics.median(t for t, _ in got):8.1f} ms  repeated {statistics.median(a for _, a in got):3.0f}   {[round(t, 1) for t, _ in got]}", flush=True)
