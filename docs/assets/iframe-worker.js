// Search from disk: browsers start no worker from file:, so what one would run runs in a hidden frame.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const own = new URL(url, document.baseURI).href
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.body.appendChild(frame)
      const inner = (this.inner = frame.contentWindow)
      this.waiting = []
      inner.postMessage = (data) => {
        const event = new MessageEvent("message", { data })
        this.dispatchEvent(event)
        if (this.onmessage) this.onmessage(event)
      }
      const load = (source) =>
        new Promise((done, failed) => {
          const script = inner.document.createElement("script")
          script.src = new URL(source, own).href
          script.onload = done
          script.onerror = failed
          inner.document.head.appendChild(script)
        })
      inner.importScripts = (...sources) =>
        sources.reduce((before, source) => before.then(() => load(source)), Promise.resolve())
      load(own).then(() => {
        this.loaded = true
        this.waiting.splice(0).forEach((data) => this.postMessage(data))
      })
    }
    postMessage(data) {
      if (!this.loaded) this.waiting.push(data)
      else this.inner.dispatchEvent(new this.inner.MessageEvent("message", { data }))
    }
    terminate() {}
  }
}
