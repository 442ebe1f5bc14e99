// Browsers start no worker for a page that was opened from disk. The search then runs in a hidden frame instead.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    #frame = document.createElement("iframe");
    #waiting = [];

    constructor(url) {
      super();
      this.#frame.hidden = true;
      document.body.append(this.#frame);
      const scope = this.#frame.contentWindow;
      scope.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      scope.importScripts = (...urls) => urls.reduce((before, one) => before.then(() => load(scope, one)), Promise.resolve());
      load(scope, url).then(() => {
        for (const data of this.#waiting.splice(0)) this.#deliver(data);
        this.#waiting = null;
      });
    }

    postMessage(data) {
      if (this.#waiting) this.#waiting.push(data);
      else this.#deliver(data);
    }

    #deliver(data) {
      const scope = this.#frame.contentWindow;
      scope.dispatchEvent(new scope.MessageEvent("message", { data }));
    }
  };
}

function load(scope, url) {
  return new Promise((done, failed) => {
    const script = scope.document.createElement("script");
    script.src = new URL(url, location.href);
    script.onload = done;
    script.onerror = failed;
    scope.document.head.append(script);
  });
}
