#include "tests/server/support/generic_call.h"

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <vector>

namespace portolan::testing {
namespace {

// One operation at a time: waits for the one that was just started.
bool WaitFor(grpc::CompletionQueue* queue) {
  void* tag = nullptr;
  bool ok = false;
  return queue->Next(&tag, &ok) && ok;
}

std::string ToBytes(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  buffer.Dump(&slices);
  std::string bytes;
  for (const grpc::Slice& slice : slices) {
    bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  }
  return bytes;
}

}  // namespace

StatusOr<std::unique_ptr<google::protobuf::UnknownFieldSet>> GenericCall(
    const std::string& address, const std::string& method,
    const google::protobuf::UnknownFieldSet& request) {
  std::string bytes;
  request.SerializeToString(&bytes);
  const grpc::Slice slice(bytes);
  const grpc::ByteBuffer message(&slice, 1);
  grpc::GenericStub stub(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const auto call = stub.PrepareCall(&context, method, &queue);
  call->StartCall(nullptr);
  bool ok = WaitFor(&queue);
  if (ok) {
    call->Write(message, nullptr);
    ok = WaitFor(&queue);
  }
  if (ok) {
    call->WritesDone(nullptr);
    ok = WaitFor(&queue);
  }
  grpc::ByteBuffer answer;
  if (ok) {
    call->Read(&answer, nullptr);
    ok = WaitFor(&queue);
  }
  grpc::Status status;
  context.TryCancel();
  call->Finish(&status, nullptr);
  WaitFor(&queue);
  queue.Shutdown();
  auto fields = std::make_unique<google::protobuf::UnknownFieldSet>();
  if (!ok || !fields->ParseFromString(ToBytes(answer))) {
    return absl::UnavailableError(status.error_message());
  }
  return fields;
}

}  // namespace portolan::testing
