// Sends a stream of pages that are made one at a time, as the caller takes them.
#ifndef PORTOLAN_SERVER_RPC_PAGE_WRITER_H_
#define PORTOLAN_SERVER_RPC_PAGE_WRITER_H_

#include <grpcpp/grpcpp.h>

#include <functional>
#include <utility>

#include "common/base/status.h"
#include "server/rpc/grpc_status.h"

namespace portolan {

// Owned by gRPC: deletes itself when the call is over.
template <typename Page>
class PageWriter : public grpc::ServerWriteReactor<Page> {
 public:
  // Fills the next page; false: there is none.
  using MakePage = std::function<bool(Page*)>;

  explicit PageWriter(StatusOr<MakePage> make_page) {
    if (!make_page.ok()) {
      this->Finish(ToGrpc(make_page.status()));
      return;
    }
    make_page_ = *std::move(make_page);
    WriteNext();
  }

  void OnWriteDone(bool ok) override {
    if (ok) {
      WriteNext();
    } else {
      this->Finish(grpc::Status::CANCELLED);
    }
  }
  void OnDone() override { delete this; }

 private:
  void WriteNext() {
    page_.Clear();
    if (make_page_(&page_)) {
      this->StartWrite(&page_);
    } else {
      this->Finish(grpc::Status::OK);
    }
  }

  MakePage make_page_;
  Page page_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_PAGE_WRITER_H_
