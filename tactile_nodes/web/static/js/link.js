// The connection to the node: reconnects by itself, and acknowledges each drawn packet, so that no more are sent
// than this page can show.

const RETRY_MS = [200, 500, 1000, 2000];
const SILENT_MS = 3000; // the node sends more often than that, to a page that is seen
const TRY_AGAIN_LATER = 1013; // code with which the node closes a connection of one page too many

export class Link {
  /** `sensor` is the name of a sensor, if the node shows several. */
  constructor(onPacket, onChange, sensor = null) {
    this.query = sensor === null ? {} : { sensor };
    this.open = false;
    this.refusal = ''; // why the node closed the last connection at once
    this.onPacket = onPacket;
    this.onChange = onChange;
    this.mayAct = undefined; // until the node has sent it
    this.failures = 0;
    this.heardAt = performance.now();
    this.connect();
  }

  /** Whether nothing comes although the connection is open: the node hangs, or the network on the way to it. */
  get silent() {
    return !document.hidden && performance.now() - this.heardAt > SILENT_MS;
  }

  connect() {
    const socket = new WebSocket(`ws://${location.host}/live?${new URLSearchParams(this.query)}`);
    socket.binaryType = 'arraybuffer';
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = ({ code, reason }) => this.comeBack(code === TRY_AGAIN_LATER ? reason : '');
    this.socket = socket;
  }

  take(data) {
    this.heardAt = performance.now();
    if (typeof data === 'string') {
      this.mayAct = JSON.parse(data).may_act;
      this.failures = 0;
      this.become(true);
    } else {
      this.onPacket(data);
    }
  }

  comeBack(refusal) {
    this.refusal = refusal;
    this.become(false);
    const wait = RETRY_MS[Math.min(this.failures, RETRY_MS.length - 1)];
    this.failures += 1;
    setTimeout(() => this.connect(), wait);
  }

  become(open) {
    this.open = open;
    this.onChange(open);
  }

  /** Acknowledge the last packet, which is on the screen. */
  drawn() {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send('drawn');
  }

  /** Requests an action from the node; resolves to {done, text, insistable}. */
  async act(action, insist = false) {
    try {
      const path = `/control/${action}?${new URLSearchParams({ ...this.query, ...(insist ? { insist: 'yes' } : {}) })}`;
      const response = await fetch(path, { method: 'POST' });
      if (response.headers.get('Content-Type')?.startsWith('application/json')) return await response.json();
      return { done: false, text: await response.text() };
    } catch {
      return { done: false, text: 'The live view does not respond.' };
    }
  }
}
