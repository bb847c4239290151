/* Search runs in a worker, which browsers refuse to load from file://. There, run its script in a hidden frame. */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    #waiting = [];
    #frame = document.createElement("iframe");

    constructor(url) {
      super();
      this.#frame.hidden = true;
      this.#frame.onload = () => this.#start(url);
      this.#frame.srcdoc = "<!doctype html>";
      document.documentElement.append(this.#frame);
    }

    #start(url) {
      const frame = this.#frame.contentWindow;
      frame.postMessage = (data) => this.#report(data);
      const script = frame.document.createElement("script");
      script.src = new URL(url, location.href).href;
      script.onload = () => {
        const waiting = this.#waiting;
        this.#waiting = null;
        waiting.forEach((data) => this.postMessage(data));
      };
      script.onerror = (event) => this.onerror?.(event);
      frame.document.body.append(script);
    }

    #report(data) {
      this.#later(data, (event) => {
        this.onmessage?.(event);
        this.dispatchEvent(event);
      });
    }

    #later(data, deliver) {
      const copy = structuredClone(data);
      setTimeout(() => deliver(new MessageEvent("message", { data: copy })));
    }

    postMessage(data) {
      if (this.#waiting) this.#waiting.push(data);
      else this.#later(data, (event) => this.#frame.contentWindow?.dispatchEvent(event));
    }

    terminate() {
      this.#frame.remove();
    }
  };
}
